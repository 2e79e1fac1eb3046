import"./chunk-A7OK6EBF.js";import{o as e,v as t}from"./chunk-E6BSTD65.js";function o(){return e(t,{title:"People",text:"This page is being built."})}export{o as People};
