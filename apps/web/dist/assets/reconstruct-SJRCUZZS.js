import"./chunk-A7OK6EBF.js";import{o as t,v as e}from"./chunk-E6BSTD65.js";function o(){return t(e,{title:"Reconstruct",text:"This page is being built."})}export{o as Reconstruct};
