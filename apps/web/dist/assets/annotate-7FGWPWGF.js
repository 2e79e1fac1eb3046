import"./chunk-A7OK6EBF.js";import{o as t,v as e}from"./chunk-E6BSTD65.js";function i(){return t(e,{title:"Annotate",text:"This page is being built."})}export{i as Annotate};
