import"./chunk-A7OK6EBF.js";import{o as i,v as t}from"./chunk-E6BSTD65.js";function n(){return i(t,{title:"Train",text:"This page is being built."})}export{n as Train};
